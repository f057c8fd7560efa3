"""Figures of a run, which register themselves."""
