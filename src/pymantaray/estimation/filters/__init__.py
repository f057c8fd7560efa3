"""Sequential estimators: Kalman filter, fixed lag, iSAM2."""
