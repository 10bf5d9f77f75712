"""The mechanism by kernels: what is readable beside this folder, at a fraction of the time."""
