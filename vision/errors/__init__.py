"""Uncertainty of each displacement: independent noise, and errors that many values share ("modes").

Read in this order. At rest: `staticnoise` is the scatter in the static film, its memory from frame to frame
and the states of patches, `restdrift` a finger that did not rest. Video compression: `reencoding` codes the
film's own frames once more, `codingvariance` makes variances of that by state of the patch, `codingdrift` is
the part that stays in resting marks from key frame to key frame. Every value: `independenterrors` are
variances, `sharederrors` modes by name, for example a wrong scale. `errormodel` puts all of them together,
for one camera and for several; `errorbudget` is the table by source.
"""
