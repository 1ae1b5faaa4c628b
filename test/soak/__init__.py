"""Load and faults: odd messages of every kind, latencies, what happens to machines and clocks."""
