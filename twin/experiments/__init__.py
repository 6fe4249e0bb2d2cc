"""Experiments to film or to measure next, where these data cannot tell two effects apart.

Read `choice` first: the experiments there are, and how well each would tell what is tied. `plannedfilms`
solves what a model would show in a film that was not made yet, `plannederrors` says how well that film would
be known, and how far apart two models stay when the one imitates the other. `benchchecks` are the tests that
need no model: a gauge checked, a finger weighed, a marker looked at. `designs` spreads runs over ranges of
anything, and says what each variable did in them.
"""
