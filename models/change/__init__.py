"""What has changed in a stage that was in order: one cause alone, and a model that is right."""
