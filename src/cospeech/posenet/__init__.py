"""3D pose from one image (thesis chapter 3): network, losses, metrics and the camera that a crop stands for.

The joint sets of MPI-INF-3DHP share their names, so a map from one to another is a look-up:
`poses[:, JOINTS28.joints(*JOINTS17.names)]` cuts the 17 relevant joints out of a training annotation (N, 28, 3).
"""

from cospeech.skeleton import Skeleton

JOINTS28 = Skeleton.load("mpi_inf_3dhp28")  # the training annotation
JOINTS17 = Skeleton.load("mpi_inf_3dhp17")  # the test set
JOINTS21 = Skeleton.load("mpi_inf_3dhp21")  # the network's output
EVALUATED = JOINTS17.names[:14]  # counted by PCK and AUC; also the joints that have a heatmap
