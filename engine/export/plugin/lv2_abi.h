/* LV2, later */
