"""The mechanism in Pinocchio and NumPy, to be read: what kernels are compared with."""
