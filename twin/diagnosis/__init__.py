"""Does the model agree with the measurement, where not, and which physical effect is missing?

Read `procedure` first: it is the whole diagnosis on one page. `whitening` turns residuals into independent
values; `comparison` tests them; `fitting` fits parameters; `screening` scores every absent effect;
`refitting` fits the best of them; `verdicts` concludes. `candidates` holds the record that these pass on.
"""
