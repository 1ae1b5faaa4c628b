"""What is given: rod, pose, cut-out (frozen values, SI units)."""
