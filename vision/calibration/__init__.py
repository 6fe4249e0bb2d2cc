"""Cameras with the covariance of all their numbers, from pictures of a printed board.

Read `lens` (the fit of every lens model) and `intrinsics` (the choice of one, and what refuses bad pictures)
first. Several cameras that see one board become a rig in `stereo`, by `bundle` and `rig`. `camerafile` reads
cameras that other programs calibrated. What a board is stands in `vision.boards`.
"""
