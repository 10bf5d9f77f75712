"""What will run for a scene, and what will not: the plan compiled from it, as data."""
