"""Figures: style, colours, drawings of water, and files."""
