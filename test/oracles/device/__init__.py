"""The readable device, in plain NumPy and Pinocchio, that kernels are compared with."""
