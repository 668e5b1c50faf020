"""Scoring of answers.

labelled_answers: reads answers together with their labels; judgement: one answer; subsets, figures, score: figures with
intervals; measures: definitions of the figures and their goals; calibration: statistics; table, failures: text.
"""
