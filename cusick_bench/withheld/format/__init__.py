"""Documents of a withheld suite: answers and labels.

answer: `Answer`; label: `Label`; checked_json: reading with the place of what is wrong; causes: names and classes;
location: regions of the cloth; seal: commitments.
"""
