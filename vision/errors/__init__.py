"""How well each displacement is known: independent noise, and errors that many values share ("modes").

Read in this order. `noise` is what scatters at rest, and what patches of the picture do. `autocorrelation`
tells how long noise lasts, `restcheck` whether the finger rested at all. `reencoding` codes the film's own
frames once more, and `compression` makes terms of the error model from that. `variance` is the independent
variance of every place. `modes` are the shared errors by name, for example a wrong scale; `codingdrift` are
those that stay in resting marks until coding draws them anew. `errorbudget` sums all of them up by source.
"""
