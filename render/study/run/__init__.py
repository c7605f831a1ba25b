"""One participant's run: screens, stimuli on the array, and answers on disk before the next one is asked."""
