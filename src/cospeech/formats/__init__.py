"""Files of other programs: motion capture in; BVH, glTF and CSV out."""
