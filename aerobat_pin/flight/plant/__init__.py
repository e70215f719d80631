"""The plant: the robot in its scenario, and the kernels that fly it."""
