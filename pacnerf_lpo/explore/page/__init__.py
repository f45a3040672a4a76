"""The page of a session: what a person sees and touches."""
