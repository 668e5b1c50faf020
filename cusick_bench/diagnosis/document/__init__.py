"""The diagnosis as a document: what is written to a file, drawn as a page, or given as the answer to a withheld case.

model: `DiagnosisDocument`, its fields with units, its writer and its reader; answer: the fields that answer a withheld
case; part: what all parts of a document share; build: makes both from a `Diagnosis`; with_effect: causes as
arguments of `--with-effect`; headline: the verdict in a sentence; statistic_rows: the statistics of data and model side
by side.
"""
