"""From a laboratory's folder to one page: drape coefficient, stiffness with an interval, diagnosis, what to do next.

identify: the whole way, resumable; data: photographs or silhouettes as a data set; fits: stiffness from one typical
drape of each fabric; diagnoses: what the simulator leaves out; document: `identify.json`; page: `identify.html`.
"""
