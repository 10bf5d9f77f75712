"""Ablation: what each feature of a scene costs in a tick, and what one that is not used costs."""
