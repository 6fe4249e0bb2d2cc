"""A test and effects become predicted displacements with derivatives and modes.

`prediction` is the model; `structure` says what it is made of (built-in finger or a deck);
`discretisation` measures the error of its mesh; `loadpaths` tabulates it over C10 and C01 for the genetic
algorithm.
"""
