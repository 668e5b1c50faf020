"""Scoring of answers.

labelled_answers: opens labels beside answers; judgement: one answer; subsets, figures, score: figures with intervals;
measures: what is measured; calibration: statistics; table, failures: text.
"""
