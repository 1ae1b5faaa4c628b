"""The package as a solver of cosseratbench, found there through an entry point of this package."""
