"""Synthetic people: the embedded data on which the pose networks are trained out of the box.

    dice -> who (anthropometry, looks), in which pose (poses, hands, faces), seen from where (views)
    -> solids (figure, head, scenes) -> picture (raster) -> batches with exact labels (generate)

`draw` is the same painter for anyone whose joints are known.
"""

from cospeech.posenet.people.draw import Canvas, draw_appearance, draw_person, person_solids
from cospeech.posenet.people.generate import make_people

__all__ = ["Canvas", "draw_appearance", "draw_person", "make_people", "person_solids"]
