"""Free vibrations that markers show: frequency and damping ratio, with their sd, against amplitude.

Read `dampedsine` (one decaying vibration that several signals share) and `freevibration` (a record in which
something is let go, cut into pieces of a few periods) in this order; `exposure` is what a camera takes from
it. `quasistatic` says which steps of targets inertia moves, without a ringing to be seen.
"""
