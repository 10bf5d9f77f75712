"""Bags, the ROS side: recorder and player."""
