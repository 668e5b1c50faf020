"""From a laboratory's folder to one page: drape coefficient, stiffness with an interval, diagnosis, what to do next.

identify: the whole procedure, resumable; data: photographs or silhouettes as a data set; fits: stiffness of each
fabric; diagnoses: effects that the simulator lacks; comparison: ranks among measured fabrics; document:
`identify.json`; page: `identify.html`.
"""
