"""Recordings of a person talking in, a model of how that person gestures out."""

__version__ = "0.2.0"
