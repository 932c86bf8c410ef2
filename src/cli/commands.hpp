// The commands of the program. Each takes its words and returns the exit status.
#pragma once

#include <span>
#include <string>

#include "arguments.hpp"

namespace servosense::cli {

struct Program {
  Command command;
  int (*run)(const Arguments&);
};

Program monitor_program();
Program identify_idle_program();
Program identify_presliding_program();
Program identify_collision_program();
Program identify_torque_band_program();
Program identify_torque_equation_program();
Program identify_torque_tolerance_program();
Program identify_reference_program();
Program identify_cutting_program();
Program identify_load_meter_program();
Program identify_modes_program();
Program identify_transfer_program();
Program identify_impact_program();
Program identify_dynamometer_program();
Program compensate_dynamometer_program();
Program report_program();
Program export_program();
Program import_program();
Program init_program();
Program lobes_program();
Program simulate_drive_program();
Program simulate_milling_program();
Program pockets_program();
Program program_motion_program();
Program program_predict_program();
Program program_check_program();
Program program_optimise_program();
Program recommend_program();
Program reconcile_program();
Program study_encoder_program();
Program study_cutoff_program();
Program study_order_program();
Program study_warm_up_program();

}  // namespace servosense::cli
