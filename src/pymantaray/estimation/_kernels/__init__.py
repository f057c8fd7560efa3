"""
Compiled kernels of least squares: residuals of poses, and Cholesky factors of blocks of six by six.
"""
