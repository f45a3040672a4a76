"""The hidden-effect benchmark: blind scenes with sealed truth, their diagnosis, and its score.

    python -m validation.hidden_effects.generate runs/hidden --first 1000 --count 200
    python -m validation.hidden_effects.run runs/hidden --jobs 2
    python -m validation.hidden_effects.score runs/hidden --keep

``generate --full three`` (or ``all``) draws videos instead, to be reconstructed from so many views and then diagnosed.
``run`` reads only what a user would have; what is hidden lies in ``truth.json``, which only ``score`` opens.
"""
