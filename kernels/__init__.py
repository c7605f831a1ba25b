"""Warp kernels: arrays in, arrays out; no file, no object, no USB.

A module is one stage. Its kernels are private (`_verb_noun`); the host function of the same name beside them is the
interface: it checks, launches and returns arrays on the device of its inputs.
"""
