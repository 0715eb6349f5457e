"""Attribution: each agent's part in its team, its influence, and rewards for others' acts."""
