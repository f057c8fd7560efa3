"""A made-up run for figures and pages."""

from made_up_run import look, made_replay, made_run, records, run, run_folder, tables, water

__all__ = ["look", "made_replay", "made_run", "records", "run", "run_folder", "tables", "water"]
