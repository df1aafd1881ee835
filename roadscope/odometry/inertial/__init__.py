"""A Kalman filter of scans and inertial samples, and how it begins."""
