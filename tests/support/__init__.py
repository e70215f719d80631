"""What several tests share: independent twins of the kernels, programs to start, robots to push."""
