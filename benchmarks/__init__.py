"""Timings of the package beside a hand-written loop and beside its peers; the paper's figures.

`python -m benchmarks --help`
"""
