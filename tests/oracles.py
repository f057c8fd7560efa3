"""Independent solvers and closed forms that tests hold the package against; none of them uses its kernels."""
