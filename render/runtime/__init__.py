"""Threads, devices, compiled kernels, time and Ctrl-C: the machinery that work runs on; nothing of haptics."""
