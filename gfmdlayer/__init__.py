"""Contact of a rigid punch with a viscoelastic layer on an elastic halfspace, by GFMD."""
