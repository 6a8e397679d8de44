"""Synthetic people: the embedded data on which the pose networks are trained out of the box.

    dice -> who (anthropometry, materials), in which pose (poses, hands, faces), seen from where (views)
    -> solids (bodies, heads, painting/scenes) -> picture (painting/raster) -> batches with exact labels (batches)

`painting/painter` is the same painter for anyone whose joints are known.
"""

from cospeech.people.batches import make_people
from cospeech.people.painting.painter import Canvas, draw_appearance, draw_person, person_solids

__all__ = ["Canvas", "draw_appearance", "draw_person", "make_people", "person_solids"]
