// What cutting_generator.hpp has recorded, as reconcile reads it.
#pragma once

#include "cutting_generator.hpp"
#include "servosense/reconcile/cutting.hpp"

namespace cutting_generator {

inline servosense::reconcile::CuttingData data_of(const Record& record,
                                                  const servosense::MillingTool& tool,
                                                  const servosense::MillingCut& cut) {
  servosense::reconcile::CuttingData d;
  d.tool = tool;
  d.cut = cut;
  d.time_s = record.t_s;
  d.angle_rad = record.angle_rad;
  d.feed_per_tooth_m = record.feed_m;
  d.force_x_N = record.x_N;
  d.force_y_N = record.y_N;
  d.valid.assign(record.t_s.size(), true);
  return d;
}

}  // namespace cutting_generator
