"""The pressure log and how it is put on the film's clock.

`pressurelog` reads the log and the noise of the gauge; `joining` finds the time shift between log and
film.
"""
