"""Thesis chapter 5: gestures copied from a database of the speaker's own, found by speech and pose, and controlled."""

from cospeech.matching.database.motion_database import Database
from cospeech.matching.knn import KNN
from cospeech.matching.resync.fakes import FakePairs, fake_pairs
from cospeech.matching.search.match import Match
from cospeech.matching.search.matcher import Matcher

__all__ = ["KNN", "Database", "FakePairs", "Match", "Matcher", "fake_pairs"]
