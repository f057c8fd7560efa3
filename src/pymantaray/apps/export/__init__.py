"""Exports of runs and studies to formats of other programs."""
