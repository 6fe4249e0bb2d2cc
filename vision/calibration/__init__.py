"""Pictures of a printed board become cameras with the covariance of all their numbers.

`boards` finds corners or circles; `lens` fits every lens model; `intrinsics` chooses one and refuses a
bad set of pictures. For several cameras: `rig`, `bundle`, `stereo`. `camerafile` reads cameras of other
programs.
"""
