"""Does the model agree with the measurement, where not, and which effect is missing.

`whitening` turns residuals into independent values; `comparison` tests them; `fitting` fits parameters;
`procedure` goes through all candidates and concludes.
"""
