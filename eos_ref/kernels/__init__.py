"""Kernels of fix rheo: one object per kernel, the bases of its reproducing corrections, the styles that name them."""
