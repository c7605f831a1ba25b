"""A study's plan: STUDY.toml, its stimuli, blocks and questions, judged whole before anything plays."""
