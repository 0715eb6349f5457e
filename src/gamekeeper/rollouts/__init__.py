"""Rollouts: the one episode loop, interventions, reruns, workers, executors."""
