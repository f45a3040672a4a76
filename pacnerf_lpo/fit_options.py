"""What ``pacnerf-lpo fit --help`` says of the command itself, in a module that imports nothing."""

DESCRIPTION = """Identify geometry and material from a multi-view video.

usage: pacnerf-lpo fit SCENE [--out FOLDER] [--preset auto|quick|cpu|paper] [options]
       pacnerf-lpo fit SCENE SCENE ... --out FOLDER [--preset ...] [options]
       pacnerf-lpo fit --config FILE_OR_NAME [--config ...] [options]

SCENE is a folder with scene.yaml, such as init writes. Its run goes into SCENE/run, or where --out says; the same
command goes on with it.
Several scenes of one object are reconstructed one by one and identified together.
Of two options, and of two configurations, the later one counts.

examples:
  pacnerf-lpo fit scenes/drop
  pacnerf-lpo fit scenes/drop --preset quick
  pacnerf-lpo fit --config fit --config demo --outer_loop.run_dir runs/demo
  pacnerf-lpo fit --resume runs/demo"""
OPTIONS = {
    "config": "A configuration, by its file or its name; of several the later one counts.",
    "resume": "Go on with this run; takes no other option.",
    "preset": "Of fit SCENE: quick (minutes), cpu, paper, or auto: by the machine.",
    "out": "Of fit SCENE: the folder of the run; SCENE/run when not given.",
    "intervals": "true: identification ends with a fit to the outlines, weighted by errors: it gives values and 90 % "
    "intervals (a minute or two); a number: by so many particles; false: as published.",
    "truth": "A truth.json to compare with at the end, or demo.",
    "print_config": "Print the configuration as it would be run, and do nothing else.",
}
"""What options that are no section of the configuration do."""
