"""Speed: simulators side by side, on the same mechanism, checked first and timed then."""
