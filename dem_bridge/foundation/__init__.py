"""What every room may use: files, netCDF, child processes, progress, compiled kernels, checks, HTML for notebooks."""
