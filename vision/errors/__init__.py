"""How well each displacement is known: independent noise, and errors that many values share (modes).

`noise` reads what scatters at rest and what the codec adds; `variance` makes the variance of each place
from it; `modes` lists the shared errors by name; `budgeting` sums all of them up by source.
"""
