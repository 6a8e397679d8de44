"""The virtual speaker: speech, motion and face with known truth. See docs/demo.md."""

from cospeech.demo.take import read_take, write_take

__all__ = ["read_take", "write_take"]
