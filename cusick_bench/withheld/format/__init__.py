"""Documents of a withheld suite, as models.

answer: `answers.json`; label: `labels.json`; place: where an effect acts; fields: kinds of values;
checked_json: reading with the place of what is wrong; causes: names and classes; location: regions of the cloth;
seal: commitments.
"""
