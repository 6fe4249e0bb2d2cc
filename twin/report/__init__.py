"""What the runs found becomes one page that a person reads.

Read `found` first: what the newest runs say, gathered once. `facts` is everything the page shows;
`sentences`, `figures` and `waypictures` make its parts. `onfilm` sees the models through the film's camera,
and `footage` draws them over it. `page` writes the report, or a page of tables.
"""
