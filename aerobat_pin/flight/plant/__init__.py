"""The plant: the simulated robot in its scenario, and the kernels that integrate its motion."""
