"""Is the model right? A model and targets become a fit, a test of what is left, and intervals.

Read `whitening` first: residuals in mm become independent values of variance 1, by the noise at rest
(`noisefilter`) and shared errors. `lawerrors` are errors of the effects' laws. `fitting` fits parameters to
them, under the errors and priors of `likelihood`, and to the rows that tests of the silicone add
(`materialcurves`); `judged` repeats it until fit and errors belong together, `comparison` tests what is left
and says where it is; `lawerrorlevels` says how large the laws' errors are, `jointfit` whether film and tests
agree. `frame` tests the fixed markers, which no model moves. `stillnoise` makes the noise of displacements
without a static film, which `scatter` checks by what the film itself shows. `intervals` gives 95 % intervals,
`sharederrors` names errors that many values share, `tolerances` the dimensions that a result leans on,
`heldout` asks what the model foretells of data that it has not seen. `nearfit` fits along a model's response,
and solves the end. `fitrecord` is what fit.json and comparison.json hold.
"""
