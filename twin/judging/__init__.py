"""Is the model right? A model and targets become a fit, a test of what is left, and intervals.

Read `whitening` first: residuals in mm become independent values of variance 1, by the `noisefilter` and
modes, errors that many values share. `fitting` fits parameters to them, `judged` repeats it until fit and
errors belong together, `comparison` tests what is left and says where it is. No law of an effect is exact:
`lawerrors` are modes for that, `lawlevels` says how a model stands at each size of them. `frame` tests the
fixed markers, which no model moves. `intervals` gives 95 % intervals, `sharederrors` names the shared errors
that a fit would need larger than stated, `heldout` asks what the model foretells of data that it has not
seen. `record` is what fit.json and comparison.json hold.
"""
