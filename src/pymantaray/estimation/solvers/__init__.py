"""Batch solvers: problems, normal equations, optimizers, covariances."""
