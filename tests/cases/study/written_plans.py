"""Plans of studies: the founding paper's study and pilot, and a plan with every design and every kind of question."""

PAPER = """\
title = "Infill density"
participants = 18
noise_level = 0.1
consent = "I agree to take part."
[[stimulus]]
for = { object = ["cube", "tube", "dog"], strategy = ["oc", "cc"] }
name = "{object}-{strategy}"
object = "{object}"
strategy = "{strategy}"
sampling = "stm"
duration = 7.0
[[block]]
for = { object = ["cube", "tube", "dog"], opacity = [1.0, 0.7] }
name = "{object}-{opacity}"
design = "2ifc"
pairs = [["{object}-oc", "{object}-cc"]]
repetitions = 5
question = "Which one of the two shapes felt the most densely filled?"
options = ["First", "Second"]
random_keys = true
opacity = "{opacity}"
[[block.question_after]]
name = "confidence"
text = "How confident are you in your answers?"
kind = "scale"
points = 7
low_text = "not at all"
high_text = "very"
[[block.question_after]]
name = "difficulty"
text = "How difficult was the task?"
kind = "scale"
"""
PILOT = """\
title = "Pilot"
participants = 6
block_order = "fixed"
[[stimulus]]
for = { object = ["tube", "sphere", "dog", "cube", "rock"], strategy = ["oc", "cc"] }
name = "{object}-{strategy}"
object = "{object}"
strategy = "{strategy}"
duration = 20.0
[[block]]
name = "shapes"
design = "exploration"
trial_order = "fixed"
sets = [
  ["tube-oc", "tube-cc"],
  ["sphere-oc", "sphere-cc"],
  ["dog-oc", "dog-cc"],
  ["cube-oc", "cube-cc"],
  ["rock-oc", "rock-cc"],
]
[[block.question]]
name = "stimuli"
text = "Did the haptic stimuli feel different? If so, how?"
kind = "text"
[[block.question]]
name = "objects"
text = "Did the virtual objects feel physically different? If so, how?"
kind = "text"
[[block.question]]
name = "coherence"
text = "Was there a difference in terms of perceived coherence?"
kind = "text"
"""
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
