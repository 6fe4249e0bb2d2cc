"""Doubts about a recording: marks that are not, or not where, the project says.

Read `plausibility` first: it refuses marks that contradict their stated sizes and positions in the film's
first picture. `framemarks` finds the one frame mark that lies elsewhere, or two that are exchanged;
`misplacedmarks` names marks of the finger that may be glued elsewhere, and refuses none. `slips` looks at the
whole film: it names marks that came off.
"""
