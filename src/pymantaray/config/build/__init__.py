"""The door: sections and configurations become objects of the library here, and nowhere else."""
