"""Threads, devices, time and Ctrl-C: how work runs; nothing of haptics."""
