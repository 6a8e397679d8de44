"""Thesis chapter 5: gestures copied from a database of the speaker's own, found by speech and pose, and controlled."""

from cospeech.matching.database import Database
from cospeech.matching.knn import KNN, fake_pairs
from cospeech.matching.search import Match, Matcher

__all__ = ["KNN", "Database", "Match", "Matcher", "fake_pairs"]
