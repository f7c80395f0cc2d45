"""How right is what was found in a simulated log? Answers by the schema, scored against the truth."""

from tempog.evaluation.judge import evaluate
from tempog.evaluation.scores import Scores, Share
from tempog.evaluation.truth_document import truth_document

__all__ = ["Scores", "Share", "evaluate", "truth_document"]
