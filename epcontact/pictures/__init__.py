"""The pictures of a case: charts of its results, and the files that the report shows.

    power-spectrum            of the first surface, and the analytic one
    persson-magnification     areas against magnification; points: boundary elements
    persson-pressure          probability density of the pressure as a table (.json)
    pressure-distribution     probability density of the pressure of every method
    residuals                 against the iterations of every method
    loads-QUANTITY            results of each method at every load of a path
    contact-METHOD            state and pressure of the first surface from above; also
                              contact-METHOD-peak at the largest load, if the path falls
                              after it, and contact-METHOD-step-NUMBER for every load
                              with fields
    pressure-difference-A-B   pressures of two methods on one grid, and their difference
    body-METHOD               the finite-element body, cut open

Each is a picture (.png and, except for a body, .svg) with a caption (.txt) and, for a
chart, its data (.csv).  `charts` makes charts of results, `folder` writes the files.
"""
