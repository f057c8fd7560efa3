"""Levels: loss, absorption, sonar equation, interference, leakage, caustics, rough boundaries."""
