"""Capture: video in, tracks out, and from tracks the clips that everything after works on."""
