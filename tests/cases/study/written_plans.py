"""Plans of studies: the founding paper's study and pilot, and a plan with every design and every kind of question."""

from palpate.render.study.plan.study_plan import example_text

PAPER, PILOT = example_text("paper"), example_text("pilot")
HEAD = """\
title = "All"
codes = ["A1", "b-7"]
"""
STIMULI = """\
[[stimulus]]
for = { size = [4, 6, 8, 10] }
name = "{size} cm"
object = "sphere"
fit = 0.08
at = [0.0, 0.0, 0.2]
duration = 2.0
value = "{size}"
"""
BLOCKS = {
    "2ifc": """\
[[block]]
name = "pairs"
design = "2ifc"
pairs = [["4 cm", "6 cm"], ["4 cm", "8 cm"]]
question = "Which one was larger?"
""",
    "constant": """\
[[block]]
name = "constant"
design = "constant"
standard = "6 cm"
comparisons = ["4 cm", "6 cm", "8 cm"]
question = "Which one was larger?"
repetitions = 10
""",
    "staircase": """\
[[block]]
name = "staircase"
design = "staircase"
levels = ["10 cm", "8 cm", "6 cm", "4 cm"]
question = "Did you feel it?"
options = ["no", "yes"]
correct = "yes"
start = 1
down = 3
steps = [2, 1]
reversals = 6
trials_max = 40
tracks = 2
""",
    "magnitude": """\
[[block]]
name = "magnitude"
design = "magnitude"
stimuli = ["4 cm", "6 cm", "8 cm", "10 cm"]
modulus = { stimulus = "6 cm", number = 100 }
question = "How large was it?"
high = 1000
hand = false
""",
    "rating": """\
[[block]]
name = "rating"
design = "rating"
stimuli = ["4 cm", "10 cm"]
[[block.question]]
name = "rough"
text = "How rough was it?"
kind = "scale"
points = 5
[[block.question]]
name = "hard"
text = "How hard was it?"
kind = "scale"
""",
    "exploration": """\
[[block]]
name = "exploration"
design = "exploration"
sets = [["4 cm", "10 cm", "4 cm"]]
[[block.question]]
name = "kind"
text = "What was it?"
kind = "choice"
options = ["a sphere", "a cube", "nothing"]
[[block.question]]
name = "size"
text = "How large was it in cm?"
kind = "number"
low = 0
[[block.question]]
name = "else"
text = "Anything else?"
kind = "text"
optional = true
""",
}
"""By design."""
EVERY_DESIGN = HEAD + STIMULI + "".join(BLOCKS.values())
