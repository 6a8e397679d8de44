"""Trackers: whatever sees a speaker in a film becomes a track, by one protocol."""
