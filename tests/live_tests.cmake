# Real processes on a real LCM network, in wall time; live_support.py is what they share.
tether_add_script_test(NAME live_agreement_test SCRIPT live_agreement_test.py LABELS live
  TIMEOUT 180)
tether_add_script_test(NAME live_end_test SCRIPT live_end_test.py LABELS live TIMEOUT 120)
tether_add_script_test(NAME live_survival_test SCRIPT live_survival_test.py LABELS live
  TIMEOUT 180)
tether_add_script_test(NAME live_two_networks_test SCRIPT live_two_networks_test.py LABELS live
  TIMEOUT 60)
tether_add_script_test(NAME live_netem_set_test SCRIPT live_netem_set_test.py LABELS live
  TIMEOUT 120)
tether_add_script_test(NAME live_bad_input_test SCRIPT live_bad_input_test.py LABELS live
  TIMEOUT 120)
tether_add_script_test(NAME live_hostile_test SCRIPT live_hostile_test.py LABELS live TIMEOUT 120)
tether_add_script_test(NAME live_plan_test SCRIPT live_plan_test.py LABELS live TIMEOUT 120)
tether_add_script_test(NAME live_relay_test SCRIPT live_relay_test.py LABELS live TIMEOUT 120)
tether_add_script_test(NAME lockstep_process_test SCRIPT lockstep_process_test.py LABELS live
  TIMEOUT 180)
tether_add_script_test(NAME lockstep_foreign_test SCRIPT lockstep_foreign_test.py LABELS live
  TIMEOUT 180)
