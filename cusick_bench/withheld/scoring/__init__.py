"""Scoring of answers.

revealed: opens labels; judgement: one answer; score, measures, calibration: figures with intervals;
table, failures: text.
"""
