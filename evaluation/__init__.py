"""Evaluation of the codec against other methods and against its own promises; imports the codec and `lab`.

bench        every method at every setting on every scene; `measure` one point, `points` the settings
captures     the same on captures of rooms
promise      are frames as good as the presets promise?
stress       sequences that break codecs
troubles     files and folders that ask for much
speed        seconds of frames; `memory`: peak memory of long sequences
bd           differences of curves; `curves` reads them from results
sequences    scenes as folders of frames; `fresh`: commands in processes of their own

baselines    other codecs behind one interface
experiments  one question each: what is a tool of the codec worth?
tables       what stands in `docs/` and README.md; `charts`, `picture`: the pictures
results      JSON, as `lab.record` writes it
"""
