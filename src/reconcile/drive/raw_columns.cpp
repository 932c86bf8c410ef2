#include "reconcile/drive/raw_columns.hpp"

namespace servosense::reconcile {

Column raw_position(const DriveData& data) {
  Column position;
  position.reserve(data.samples.size());
  for (const auto& sample : data.samples)
    position.push_back(position.empty() ? 0 : position.back() + sample.increment);
  return position;
}

Column raw_effort(const DriveData& data) {
  Column effort;
  effort.reserve(data.samples.size());
  for (const auto& sample : data.samples) effort.push_back(sample.effort);
  return effort;
}

}  // namespace servosense::reconcile
