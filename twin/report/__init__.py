"""The report: one page on the results of all runs.

Read `story` first: the results of the newest runs, gathered once. `facts` is everything on the page;
`sentences` and `figures` make its parts. `filmprojection` projects the models on the film, for the recording,
a still and a clip. `page` writes the report, or a page of tables.
"""
