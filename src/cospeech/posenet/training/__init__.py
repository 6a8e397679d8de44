"""Training of the pose networks: batches, augmentation, losses, the stages, and how they get on."""
