"""The route of `classical.py`: recording, volume, matches, motions, segmentation, joints, score."""
