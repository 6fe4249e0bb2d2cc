"""A path of equilibria with derivatives.

`newton` finds one equilibrium; `curve` follows a history-free problem over pressure; `memory` follows a
material with memory along time (`past`: what it remembers); `loadings` handles forces that turn; `reach`
says why a path ends.
"""
