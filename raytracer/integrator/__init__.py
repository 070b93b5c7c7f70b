"""The bounce loop: camera rays become light, pass by pass.

In: rays, samples, the stages that the scene needs. Out: what each ray saw. `loop` is the table of contents.
"""
