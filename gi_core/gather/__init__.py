"""Path gathering: the reference, the static part's light at rest, the light of mobiles per frame."""
