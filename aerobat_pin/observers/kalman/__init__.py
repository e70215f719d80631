"""The Kalman filter and the smoother on any Pinocchio model."""
