"""What runs elsewhere: work pools, job templates, images and schedules."""
