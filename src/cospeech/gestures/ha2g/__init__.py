"""HA2G (Liu et al., CVPR 2022) and the baselines of its Table 1: many speakers, bone vectors, words, long speech."""
