"""The tests that `make test` leaves to `make long`, by the reason why they may wait.

`make test` judges every room in minutes, so that it is run before each commit. `make long` judges
what takes longer than that and repeats a kind that `make test` has judged once: further faults,
units, seeds and effects, whole stories of several programs, and loads of thousands. Continuous
integration runs both, and so does a plain `pytest`: no test is run by nobody.
"""

LONG: dict[str, dict[str, tuple[str, ...]]] = {
    "a whole story of several programs, which a user plays in minutes": {
        "docs/test_snippets.py": ("",),
        "daemon/api/test_tutorial.py": ("",),
        "daemon/setup/test_emulated.py": ("",),
        "daemon/setup/test_other_amplifiers.py": ("test_from_",),
        "daemon/setup/test_axes.py": ("test_the_gauge_readers_are", "test_two_axes_from"),
        "daemon/client/test_playing_on.py": (
            "test_a_loop_that_dies",
            "test_a_scan_goes_on",
        ),
        "daemon/client/test_positioner.py": (
            "test_it_is_there_when_it_says_so_and_stays",
            "test_the_examples_run",
        ),
        "daemon/commands/test_learning.py": (
            "test_zero_says_the_difference",
            "test_exercise_shows_it",
            "test_play_learns",
            "test_a_scan_without_an_end",
        ),
        "daemon/gateway/test_doctor_desk.py": ("test_an_offer_is_put_to_work",),
        "daemon/doctor/test_examination.py": (
            "test_the_process_examines",
            "test_what_changed_is_named",
        ),
        "daemon/epics/test_epics.py": (
            "test_bluesky_scans",
            "test_a_stop_ends_the_move",
        ),
        "daemon/gcs/test_pipython.py": (
            "test_it_stays_where_it_was_sent",
            "test_a_scan_by_the_wave_generator",
            "test_silent_connections_are_bounded",
            "test_three_axes_move",
            "test_a_connection_that_ends",
        ),
        "drivers/python_object/test_recipes.py": ("test_pipython",),
        "daemon/page/test_behind_a_proxy.py": (
            "test_a_browser_commands_through_the_proxy[caddy]",
            "test_a_browser_commands_through_the_proxy[nginx]",
        ),
        "daemon/commands/test_remote.py": (
            "test_status_is_one_screen",
            "test_play_watched_and_recorded",
            "test_watch_as_json",
            "test_two_kinds_of_file",
        ),
        "daemon/bus/test_versions.py": (
            "test_the_plain_client_commands",
            "test_a_daemon_of_the_older_keys",
        ),
        "daemon/bus/test_router.py": (
            "test_clients_find_and_command",
            "test_a_second_daemon_of_a_name",
        ),
        "daemon/bus/test_foreign_text.py": ("test_a_label_commands_no_terminal",),
        "daemon/commands/test_latency.py": ("test_times_the_emulated_devices",),
        "daemon/commands/test_first_hour.py": ("test_scan_takes_rate_and_reach",),
        "daemon/commands/test_probe.py": (
            "test_a_rack_is_recognised",
            "test_a_silent_or_strange",
        ),
        "daemon/client/test_ophyd_device.py": ("test_bluesky_scans_and_flies_it",),
        "daemon/page/test_server.py": (
            "test_what_is_drawn_is_what",
            "test_a_dropped_recording",
            "test_a_trajectory_is_looked_at",
        ),
        "daemon/setup/test_moving.py": ("test_a_gauge_of_another_stage",),
        "daemon/page/test_browser.py": ("test_a_daemon_that_starts",),
        "daemon/gateway/test_several_axes.py": (
            "test_the_roles_hold",
            "test_what_one_axis_refuses",
        ),
        "daemon/setup/test_folder.py": (
            "test_a_folder_is_the_same",
            "test_a_bench_that_runs",
            "test_two_set_ups",
        ),
        "daemon/terminal/test_dumb.py": (
            "test_a_terminal_that_cannot_redraw_gets_lines[None]",
            "test_a_terminal_that_cannot_redraw_gets_lines[]",
            "test_a_terminal_that_cannot_redraw_gets_lines[unknown]",
            "test_another_terminal",
        ),
        "packaging/test_resolve.py": ("test_wheels_for_all",),
        "packaging/test_wheel.py": ("",),
    },
    "a further fault of a service that `make test` kills, hangs and unplugs once each": {
        "daemon/service/test_chaos.py": (
            "test_fault[stranger_floods]",
            "test_fault[hub_unplugged]",
            "test_fault[other_dialect]",
            "test_fault[hang]",
            "test_fault[unplug_without_gateway]",
            "test_fault[hang_gateway]",
            "test_fault[hang_core]",
            "test_fault[kill_core_unplugged]",
            "test_fault[readback]",
            "test_fault[model_files]",
            "test_fault[stop_",
        ),
        "daemon/service/test_chaos_axes.py": (
            "test_fault[knob_of_y]",
            "test_fault[amplifier_gone]",
            "test_fault[leases_of_two]",
        ),
        "daemon/service/test_chaos_units.py": (
            "test_fault_of_a_unit[bpc303-",
            "test_fault_of_a_unit[kpc101-",
            "test_fault_of_a_unit[kpz101-",
        ),
        "daemon/service/test_exchanged_units.py": (
            "test_the_foreign_unit_is_never_moved[both_dead",
            "test_the_foreign_unit_is_never_moved[at_start-serial",
            "test_the_foreign_unit_is_never_moved[supervisor_dead",
            "test_the_foreign_unit_is_never_moved[loop_dead",
            "test_the_foreign_unit_is_never_moved[at_stop",
            "test_the_foreign_unit_is_never_moved[in_motion",
            "test_pin_accepts",
        ),
        "daemon/service/test_bad_logs.py": (
            "test_the_loop_comes_back_and_the_end_is_heard[a pipe without",
            "test_the_loop_comes_back_and_the_end_is_heard[a pipe that",
            "test_the_loop_comes_back_and_the_end_is_heard[a slow",
            "test_the_loop_comes_back_and_the_end_is_heard[a terminal",
            "test_the_loop_comes_back_and_the_end_is_heard[a stopped",
            "test_the_loop_comes_back_and_the_end_is_heard[/dev/full",
        ),
        "daemon/service/test_damaged_rings.py": (
            "test_a_ring_cut_short_in_use_costs_a_restart_at_most[event]",
            "test_a_ring_cut_short_in_use_costs_a_restart_at_most[telemetry]",
            "test_random_bytes_in_a_ring_that_is_in_use[command]",
            "test_safe_and_a_new_start_with_a_damaged_ring[cut]",
            "test_safe_and_a_new_start_with_a_damaged_ring[header]",
            "test_random_bytes_in_a_ring_that_is_in_use[status]",
            "test_random_bytes_in_a_ring_that_is_in_use[telemetry]",
            "test_random_bytes_in_a_ring_that_is_in_use[event]",
        ),
        "daemon/service/test_lost_folder.py": ("",),
        "daemon/service/test_supervisor.py": (
            "test_both_killed_at_once_while_high",
            "test_sighup_while_the_core",
            "test_a_core_that_had_to_be_killed",
            "test_a_gateway_without_its_port",
            "test_systemd_is_asked_for_time",
            "test_a_storm_of_sighups",
            "test_events_carry_their_time",
            "test_a_full_disk_at_the_start",
        ),
        "daemon/commands/test_interrupted.py": (
            "test_acquire_ended_in_the_midst[1]",
            "test_record_interrupted_and_killed",
            "test_acquire_ended_in_the_midst[2]",
            "test_acquire_ended_in_the_midst[9]",
            "test_acquire_ended_in_the_midst[15]",
            "test_record_beside_a_gateway",
            "test_acquire_whose_terminal_is_closed",
        ),
        "daemon/bus/test_versions.py": ("test_a_plain_client_that_is_killed",),
        "daemon/gateway/test_gateway.py": (
            "test_a_subscriber_that_stands_still",
            "test_the_core_comes_back_with_new_rings",
            "test_a_trajectory_survives_a_killed_gateway",
        ),
        "daemon/gateway/test_units_of_the_run.py": (
            "test_another_unit_after_a_stop[gateway stays]",
            "test_another_unit_after_a_refused_reload",
            "test_another_unit_after_a_stop[core]",
        ),
        "daemon/commands/test_remote.py": (
            "test_record_for_so_many_seconds_across",
            "test_a_recorder_that_stood_still",
        ),
        "daemon/page/test_server.py": ("test_a_killed_gateway_and_a_killed_page",),
        "drivers/mdt693b/test_soak.py": ("",),
        "drivers/emulated/test_bench.py": ("test_amplifier_faults",),
        "daemon/gateway/test_several_axes.py": (
            "test_the_gateway_may_be_killed",
            "test_where_one_starves",
        ),
        "daemon/client/test_held_axes.py": (
            "test_a_stop_that_is_not_answered",
            "test_a_repetition_that_was_late",
        ),
        "daemon/service/test_three_axes.py": (
            "test_a_file_with_two_axes",
            "test_the_death_of_the_core",
        ),
        "daemon/page/test_commanding.py": ("test_a_stop_waits_while",),
        "daemon/client/test_positioner.py": (
            "test_a_repetition_that_was_late_is_sent_again[late]",
            "test_a_repetition_that_was_late_is_sent_again[flood]",
        ),
        "daemon/commands/test_words.py": (
            "test_an_interrupt_during_the_imports",
            "test_an_interrupt_while_the_bench_starts_leaves_nothing_behind[0.7]",
            "test_an_interrupt_while_the_bench_starts_leaves_nothing_behind[0.9]",
        ),
        "daemon/page/test_strangers.py": ("test_a_wrong_frame",),
        "daemon/service/test_stops.py": (
            "test_a_core_that_was_suspended",
            "test_a_stop_during_a_fault",
        ),
        "daemon/service/test_two_daemons.py": (
            "test_one_port_two_run_folders",
            "test_a_second_one_on_the_same_run_folder_names_the_first[core]",
            "test_a_second_one_on_the_same_run_folder_names_the_first[safe]",
        ),
        "daemon/test_log_lines.py": (
            "test_a_writer_ends_as_it_wants_whatever_becomes_of_its_log[a stopped",
            "test_a_writer_ends_as_it_wants_whatever_becomes_of_its_log[a slow",
        ),
        "daemon/test_kernel_cache.py": (
            "test_a_planted_entry_is_not_loaded[link]",
            "test_a_planted_entry_is_not_loaded[folder]",
        ),
        "daemon/files/test_bounds.py": (
            "test_bombs[a packed text of zeros]",
            "test_bombs[a key of 100 000 parts]",
            "test_bombs[a pipe as a recording]",
            "test_bombs[100 000 blocks]",
            "test_bombs[a pipe as a model]",
            "test_bombs[notes without end]",
            "test_bombs[an endless device]",
        ),
    },
    "the same on a further unit, engine or key": {
        "drivers/apt/test_in_the_loop.py": (
            "test_another_unit_at_the_port_gets_no_voltage[kpc101]",
            "test_without_the_gauge",
            "test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump[unplugged-bpc303",
            "test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump[unplugged-kpc101",
            "test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump[stuck-bpc303",
            "test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump[stuck-kpc101",
            "test_another_unit_at_the_port_gets_no_voltage[bpc303]",
            "test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump"
            "[mute-",
            "test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump"
            "[late-",
            "test_without_its_gauge",
        ),
        "daemon/loop/test_process.py": (
            'test_reload_swaps_a_good_model_and_refuses_a_broken_one[engine = "compiled"]',
            'test_sigterm_ramps_to_the_safe_voltage[engine = "python"]',
            'test_a_trimmed_stage_stands_where_the_gauge_says[engine = "compiled"]',
            "test_serial_bench_unplug_and_back",
            'test_reload_swaps_a_good_model_and_refuses_a_broken_one[engine = "python"]',
            'test_a_trimmed_stage_stands_where_the_gauge_says[engine = "python"]',
            'test_one_kilohertz_on_the_simulated_stage[engine = "python"]',
        ),
        "daemon/loop/test_missed.py": (
            "test_a_higher_priority_and_a_stopped_process_are_named[python]",
        ),
        "daemon/bus/test_security.py": (
            "test_a_command_sent_again_under_the_same_lease_is_refused[certificate]",
            "test_the_commands_take_credentials[password]",
            "test_operator_commands_observer_sees_nobody_else_connects[certificate]",
            "test_the_commands_take_credentials[certificate]",
        ),
        "drivers/mdt693b/test_driver.py": (
            "test_replies_in_pieces[1-1.05]",
            "test_a_hang_is_reported_not_queued_and_survived[1.05]",
            "test_a_hang_is_reported_not_queued_and_survived[1.10]",
            "test_replies_in_pieces[2",
        ),
        "packaging/test_systems.py": (
            "test_the_page_is_served[darwin]",
            "test_a_configuration_names_its_run_folder_without_a_users_number[darwin]",
            "test_a_command_runs_to_its_end[darwin",
            "test_all_of_the_library_is_imported[darwin]",
            "test_all_of_the_library_is_imported[win32]",
            "test_a_command_runs_to_its_end[win32",
        ),
        "packaging/test_debian.py": ("",),
        "packaging/test_site.py": ("",),
        "daemon/page/test_pictures.py": (
            "test_the_most_used_comes_first_and_nothing_is_cut_or_half_empty[3-1280]",
            "test_arrows_move_the_axes_of_the_plane[3]",
            "test_a_picture_can_be_taken[3-1280]",
            "test_the_most_used_comes_first_and_nothing_is_cut_or_half_empty[1-1280]",
            "test_a_picture_can_be_taken[1-3840]",
            "test_a_picture_can_be_taken[3-3840]",
            "test_a_picture_can_be_taken[1-1280]",
            "test_a_picture_can_be_taken[3-360]",
            "test_the_most_used_comes_first_and_nothing_is_cut_or_half_empty[1-3840]",
            "test_the_most_used_comes_first_and_nothing_is_cut_or_half_empty[3-360]",
            "test_the_most_used_comes_first_and_nothing_is_cut_or_half_empty[3-3840]",
            "test_all_charts_have_one_axis_of_time[1]",
            "test_noise_at_rest_is_a_small_part_of_the_picture[1]",
        ),
        "daemon/bus/test_router.py": (
            "test_a_router_that_asks_for_credentials_enforces_the_roles[certificates]",
        ),
        "daemon/test_examples.py": (
            "test_without_a_daemon_it_ends_in_one_line[arguments0",
            "test_without_a_daemon_it_ends_in_one_line[arguments1",
        ),
        "daemon/files/test_recorder.py": (
            "test_a_kill_costs_no_more_than_what_was_held[100-mcap]",
            "test_what_is_said_of_a_full_disk_is_true[csv.gz]",
            "test_a_kill_costs_no_more_than_what_was_held[10000-mcap]",
            "test_what_is_said_of_a_full_disk_is_true[mcap]",
            "test_the_disk_holds_no_more_than_it_may[csv.gz]",
            "test_the_disk_holds_no_more_than_it_may[mcap]",
        ),
        "drivers/emulated/test_another_client.py": (
            "test_in_the_legacy_dialect",
            "test_the_emulated_unit_as_it_is",
        ),
        "daemon/service/test_chaos_units.py": (
            "test_fault_of_a_unit[mdt694b-unplug",
            "test_fault_of_a_unit[mdt694b-foreign",
            "test_fault_of_a_unit[mdt694b-late",
        ),
        "drivers/mdt693b/test_together.py": ("test_the_rate_is_that_of_the_outputs",),
        "daemon/setup/test_other_amplifiers.py": (
            "test_an_mdt694b_is_found",
            "test_one_axis_is_what_it_has[mdt694b]",
            "test_one_axis_is_what_it_has[bpc303]",
            "test_one_axis_is_what_it_has[kpz101]",
        ),
        "daemon/page/test_strangers.py": (
            "test_guesses_are_slow_whichever_way_and_nobody_else_waits[by_header]",
            "test_guesses_are_slow_whichever_way_and_nobody_else_waits[by_text",
            "test_guesses_are_slow_whichever_way_and_nobody_else_waits[by_socket",
        ),
        "daemon/commands/test_printed_commands.py": (
            "test_a_screen_of_any_encoding_shows_what_it_can[utf-8]",
            "test_a_screen_of_any_encoding_shows_what_it_can[latin-1]",
        ),
        "daemon/loop/test_channels.py": ("test_the_running_core_follows_a_temperature[python]",),
        "daemon/commands/test_latency.py": ("test_measures_the_loop_and_says_so_in_json[python]",),
        "drivers/kpc101/test_driver.py": (
            "test_a_late_position_is_not_taken_for_the_next_one[False]",
        ),
        "daemon/epics/test_epics.py": ("test_beacons",),
        "daemon/gcs/test_pipython.py": ("test_killed_in_motion",),
        "daemon/commands/test_probe.py": ("test_a_kpc101_and_its_gauge",),
        "daemon/page/test_behind_a_proxy.py": (
            "test_all_that_the_page_needs_is_below_its_path[nginx]",
        ),
        "daemon/test_kernel_cache.py": ("test_a_planted_entry_is_not_loaded[mode]",),
        "daemon/files/test_foreign_roles.py": (
            "test_the_advice_for_structures_of_matlab_names_one[1]",
        ),
        "daemon/files/test_named_beside.py": (
            "test_units_by_the_names_of_the_columns[units",
            "test_units_by_the_names_of_the_columns[{}_unit]",
        ),
    },
    "a load of thousands, or a wait of ten seconds and more": {
        "daemon/page/test_strangers.py": (
            "test_guesses_are_slow_whichever_way_and_nobody_else_waits[by_form]",
            "test_2000_questions",
            "test_who_answers_no_ping",
            "test_silent_connections_before_tls",
            "test_500_connections",
            "test_a_body_of_which_nothing_comes",
        ),
        "daemon/page/test_server.py": (
            "test_a_set_point_is_kept",
            "test_a_preview_is_played_where",
            "test_one_page_for_two",
            "test_with_passwords_nothing_without_one",
            "test_all_axes_of_a_controller",
            "test_it_waits_for_a_daemon",
        ),
        "daemon/bus/test_router.py": ("test_nothing_is_lost",),
        "daemon/bus/test_hostile.py": ("test_subscribers_that_do_not_read",),
        "daemon/loop/test_compiled_apart.py": ("test_each_half",),
        "daemon/loop/test_slew_by_the_clock.py": ("test_the_amplifiers_own_log",),
        "daemon/commands/test_stay_option.py": ("test_a_place_is_kept",),
        "models/physics/test_address.py": ("test_a_second_process",),
        "daemon/page/test_browser.py": (
            "test_what_was_found_of_a_recording",
            "test_a_file_that_is_given_while",
            "test_arrows_step_and_space",
            "test_a_killed_gateway_and_a_killed_page",
        ),
        "daemon/rings/test_ring.py": ("test_no_torn_record_reaches_a_slow",),
    },
    "a further file, option or picture of a kind that `make test` judges with others": {
        "daemon/report/test_every_picture.py": (
            "test_a_picture_of_a_recording_that_shows_little_is_drawn[constant",
            "test_a_picture_of_a_recording_that_shows_little_is_drawn[one",
            "test_a_picture_of_a_recording_that_shows_little_is_drawn[tiny",
            "test_a_picture_of_a_recording_that_shows_little_is_drawn[huge",
            "test_a_picture_of_a_recording_that_shows_little_is_drawn[zero",
        ),
        "daemon/test_ends.py": (
            "test_a_command_whose_output_is_lost_says_so_and_is_no_success[drivers --json",
            "test_a_command_whose_output_is_lost_says_so_and_is_no_success[excite",
            "test_a_command_whose_output_is_lost_says_so_and_is_no_success[config",
        ),
        "daemon/files/test_stated_scales.py": (
            "test_a_factor_beside_the_numbers_is_asked_for[conversion",
            "test_a_factor_beside_the_numbers_is_asked_for[lsb",
            "test_a_factor_beside_the_numbers_is_asked_for[multiplier",
        ),
        "daemon/files/test_contradictions.py": (
            "test_a_rate_next_to_times_of_another_is_said[sample_rate",
            "test_a_rate_next_to_times_of_another_is_said[Fs-0.2",
            "test_a_gain_above_the_numbers_of_a_spreadsheet_is_asked_for[2]",
        ),
        "daemon/files/test_bounds.py": (
            "test_bombs[the same in quotes]",
            "test_bombs[a pipe as credentials]",
        ),
        "daemon/client/test_threads_and_forks.py": (
            "test_in_a_forked_child_a_fresh_client_works_and_an_inherited_one_says_so[twice",
            "test_in_a_forked_child_a_fresh_client_works_and_an_inherited_one_says_so[locked",
            "test_in_a_forked_child_a_fresh_client_works_and_an_inherited_one_says_so[multi",
        ),
        "daemon/commands/test_outputs.py": (
            "test_a_name_that_is_not_utf_8_is_written_escaped[bad",
        ),
        "daemon/commands/test_words_of_motion.py": (
            "test_an_interrupt_says_what_the_stage_does_now[words1",
        ),
        "daemon/test_examples.py": ("test_example_runs[arguments1", "test_example_runs[arguments2"),
        "daemon/page/test_browser.py": ("test_on_a_telephone", "test_accepting_asks"),
        "daemon/page/test_strangers.py": (
            "test_guesses_are_slow_whichever_way_and_nobody_else_waits[by_token]",
        ),
        "daemon/page/test_behind_a_proxy.py": ("test_a_proxy_may_leave_the_path[nginx]",),
        "daemon/epics/test_epics.py": ("test_camonitor_sees", "test_another_client"),
        "daemon/commands/test_probe.py": (
            "test_a_piezo_driver_is_recognised_and_not_touched[unit1]",
            "test_a_unit_is_recorded_and_understood[1.05]",
        ),
        "drivers/mdt693b/test_together.py": (
            "TestContractBesideOthers",
            "test_all_three_in_one_command_where_the_firmware_can[1.09",
        ),
        "drivers/apt/test_in_the_loop.py": (
            "test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump[unplugged-kpz101",
        ),
        "daemon/service/test_chaos.py": (
            "test_fault[sensor_invalid]",
            "test_fault[sensor_lost_while_reloading]",
            "test_fault[disk_read_only]",
            "test_fault[file_limit]",
            "test_fault[half_reply]",
        ),
        "models/diagnosis/test_names.py": (
            "test_a_stage_of_a_foreign_class",
            "test_only_a_limit_with_a_size",
            "test_effects_stand_in_the_order",
        ),
        "models/diagnosis/test_stage_changes.py": ("test_a_change_that_lasts",),
        "models/diagnosis/test_beside_the_model.py": ("test_coupling_through_a_lag",),
        "models/diagnosis/test_data_first.py": (
            "test_the_steps_of_a_reading_are_no_pattern_of_its_sensor[20]",
            "test_a_gauge_that_is_stuck_or_at_its_limit_is_no_physics[at its limit]",
            "test_coarse_steps",
        ),
        "benchmarks/models/test_proof.py": (
            "test_a_quick_drive_next_to_a_mode",
            "test_a_model_that_the_recordings_do_not_determine",
        ),
    },
    "a diagnosis of a further effect, stage or seed": {
        "models/identify/test_own_starts.py": (
            "test_hum_in_the_others",
            "test_a_recording_that_does_not_belong_is_named_and_the_others_are_used[of_a_gauge_that_is_off-2",
            "test_a_recording_that_does_not_belong_is_named_and_the_others_are_used"
            "[of_another_gain",
            "test_a_recording_that_does_not_belong_is_named_and_the_others_are_used"
            "[of_a_gauge_that_is_off-0",
            "test_readings_after_an_edge_that_the_stage_follows_late_are_not_lone[0.0",
        ),
        "models/identify/test_outside.py": (
            "test_a_slow_scan_with_a_fast_wiggle_is_no_drift[4.0]",
            "test_pure_noise_is_no_butterfly[0.",
            "test_pure_noise_is_no_butterfly[1.0]",
            "test_the_rests_of_a_staircase_show_a_lag_of_any_length[0.0",
            "test_a_drift_beside_a_drive_of_one_period",
        ),
        "models/identify/test_intervals.py": (
            "test_95_of_100_intervals_hold_the_true_value[white]",
            "test_95_of_100_intervals_hold_the_true_value[noise",
        ),
        "models/diagnosis/test_growth.py": ("",),
        "models/diagnosis/test_beside_the_model.py": (
            "test_a_zero_that_wanders",
            "test_creep_added_to_a_stage",
            "test_a_drive_held_after",
            "test_a_shape_beside_an_effect",
            "test_coupling_through_a_lag[0.012]",
        ),
        "models/diagnosis/test_data_first.py": (
            "test_the_recording_that_alone_shows",
            "test_the_recording_that_a_given_model_misses",
            "test_an_open_input",
        ),
        "models/diagnosis/test_hard_recordings.py": (
            "test_a_line_on_a_harmonic",
            "test_a_delay_at_few_moments",
            "test_a_slew_limit_that_few",
            "test_with_little_noise_what_the_base_leaves_is_no_physics[in the class]",
            "test_slow_sampling",
            "test_with_little_noise_what_the_base_leaves_is_no_physics[foreign",
            "test_a_limit_holds_when_the_effect_is_put_in",
        ),
        "models/diagnosis/test_names.py": (
            "test_interval_holds_the_truth",
            "test_hidden_effect_is_named_first_and_the_model_predicts[delay]",
            "test_result_is_json_by_contract",
            "test_hidden_effect_is_named_first_and_the_model_predicts[hum]",
            "test_hidden_effect_is_named_first_and_the_model_predicts[creep]",
            "test_structure_outside",
            "test_hidden_effect_is_named_first_and_the_model_predicts[slew]",
            "test_hidden_effect_is_named_first_and_the_model_predicts[coupling]",
            "test_hidden_effect_is_named_first_and_the_model_predicts[resonance]",
            "test_hidden_effect_is_named_first_and_the_model_predicts[drift]",
        ),
        "models/diagnosis/test_written_model.py": (
            "test_an_effect_of_another_size_in_each_recording_is_not_named[4]",
            "test_a_line_whose_phase",
            "test_a_part_that_gives_a_value",
            "test_an_effect_of_another_size_in_each_recording_is_not_named[40]",
            "test_hum_in_a_servo",
            "test_what_is_left_in_rows_left_out",
            "test_rows_without_a_channel",
        ),
        "models/diagnosis/test_rests.py": (
            "test_a_mode_that_rings_after_steps_alone_is_named[350.0-random",
            "test_a_mode_that_rings_after_steps_alone_is_named[350.0-two",
            "test_a_mode_beside_a_quiet_recording",
            "test_the_written_model_predicts_other_steps_and_a_sine[1]",
            "test_a_mode_that_rings_after_steps_alone_is_named[110.0",
        ),
        "models/diagnosis/test_rate.py": (
            "test_loops_that_widen",
            "test_loops_that_narrow",
        ),
        "models/diagnosis/test_friction.py": ("test_friction_on_a_stage_that_runs_back",),
        "models/diagnosis/test_diagnosed_model.py": (
            "test_a_model_of_another_stage_is",
            "test_a_delay_on_a_stage_of_the_models_class",
            "test_the_given_model_is_what",
            "test_what_the_base_explains",
        ),
        "models/diagnosis/test_between.py": (
            "test_a_shape_that_ten_places",
            "test_one_recording_of_ten_places",
            "test_a_delay_is_reported",
        ),
        "models/diagnosis/test_real.py": (
            "test_coupling_through_several_modes",
            "test_coupling_through_a_mode",
        ),
        "replay/test_diagnose_real.py": (
            "test_the_written_model_follows",
            "test_what_began_before",
        ),
        "benchmarks/models/test_proof.py": (
            "test_what_no_reading_determines",
            "test_a_drift_from_before_two",
            "test_an_effect_without_which",
            "test_a_small_effect_of_the_drive",
            "test_a_recording_that_shows_most",
            "test_what_two_recordings_do_not",
            "test_a_quiet_stage",
            "test_a_delay_by_part_of_a_sample",
        ),
        "daemon/benchmark/test_bench.py": ("",),
        "daemon/imaging/test_image.py": ("",),
        "daemon/benchmark/test_run.py": (
            "test_the_made_stages_are_the_same",
            "test_every_hidden_effect_is",
        ),
        "models/mismatch/test_monitor.py": (
            "test_what_adds_twice_the_noise_is_flagged_in_time[creep]",
            "test_what_adds_twice_the_noise_is_flagged_in_time[gain]",
        ),
        "models/inverse/test_compensator.py": (
            "test_few_random_models",
            "test_limits_hold_and_preview",
        ),
        "models/identify/test_dynamics.py": (
            "test_the_side_of_a_long_lag_is_reported[drive]",
            "test_a_lag_is_found[drive-0.015]",
            "test_a_lag_is_found[sensor",
        ),
        "models/identify/test_lag_kinds.py": (
            "test_how_the_input_of_a_lag_moves_between_samples_is_found[staircase-drive-in lines]",
            "test_how_the_input_of_a_lag_moves_between_samples_is_found[staircase-drive-held",
            "test_how_the_input_of_a_lag_moves_between_samples_is_found[staircase-sensor",
            "test_one_drive_shows_what_it_is_and_predicts_another[lag-raster]",
            "test_how_the_input_of_a_lag_moves_between_samples_is_found[raster",
            "test_one_drive_shows_what_it_is_and_predicts_another[delay",
        ),
        "models/identify/test_rate.py": (
            "test_weights_that_depend_on_the_rate_are_not_taken_for_a_lag_about_a_bias[9901]",
            "test_weights_that_depend_on_the_rate_are_not_taken_for_a_lag_about_a_bias[9904]",
        ),
        "daemon/doctor/test_ends.py": (
            "test_a_diagnosis_of_a_stage_at_rest",
            "test_findings_are_kept_where",
            "test_a_stage_at_rest_is_examined_and_all_pictures_of_its_report_are_drawn[3.0]",
            "test_a_stage_at_rest_is_examined_and_all_pictures_of_its_report_are_drawn[0.3]",
        ),
        "models/diagnosis/test_times.py": ("test_creep_of_an_earlier",),
        "models/diagnosis/test_stage_changes.py": (
            "test_a_ramp_is_no_sudden_change",
            "test_what_a_base_fits_of_the_noise",
            "test_the_written_model_is_judged_by_the_readings_as_they_are[4]",
            "test_a_change_is_not_told_where_its_gain",
            "test_a_stage_that_follows_a_temperature",
            "test_the_written_model_is_judged_by_the_readings_as_they_are[28]",
            "test_a_sudden_change_is_told_with_its_time_and_no_slow_physics[4]",
            "test_a_sudden_change_is_told_with_its_time_and_no_slow_physics[28]",
        ),
        "models/identify/test_failed_fits.py": (
            "test_a_recording_in_two_parts_is_fitted_as_well_as_whole[1]",
            "test_a_recording_in_two_parts_is_fitted_as_well_as_whole[2]",
            "test_a_drift_is_not_claimed_where_the_loops_only_shrink[1]",
            "test_a_drift_is_not_claimed_where_the_loops_only_shrink[2]",
            "test_a_large_drift_does_not_count_against_the_model[1]",
            "test_a_large_drift_does_not_count_against_the_model[2]",
            "test_a_decaying_sine_of_another_class_is_static[1",
            "test_a_decaying_sine_of_another_class_is_static[2",
        ),
        "models/identify/test_sense.py": ("test_recordings_of_different_stages",),
        "models/diagnosis/test_intervals.py": (
            "test_95_of_100_intervals_hold_the_true_value[rich_base",
        ),
        "models/learning/test_trim.py": ("test_a_gauge_that_stays_wrong",),
        "models/identify/test_what_is_shown.py": (
            "test_a_stop_is_remarked[up]",
            "test_creep_in_slow_loops_of_one_rate_is_no_lag[0.04]",
        ),
        "daemon/commands/test_other_files.py": (
            "test_each_command_says_once_how_a_file_was_understood[diagnose german",
        ),
        "models/identify/test_timing.py": ("test_readings_that_are_stale_by_chance",),
        "benchmarks/models/test_whose_lag.py": ("test_a_curve_that_does_not_settle",),
        "daemon/doctor/test_story.py": ("test_a_stage_in_order_raises",),
    },
}
"""Files below tests/ by the reason, and how the names of their tests begin."""


def is_long(name: str) -> bool:
    """Return whether `make test` leaves this test to `make long`; its name as pytest gives it."""
    path, _, test = name.removeprefix("tests/").partition("::")
    return any(test.startswith(kind.get(path, ())) for kind in LONG.values())


def may_hold(path: str, long: bool) -> bool:
    """Return whether this file below tests/ may hold tests of `make long`, or of `make test`."""
    begins = [kind[path] for kind in LONG.values() if path in kind]
    return bool(begins) if long else ("",) not in begins
