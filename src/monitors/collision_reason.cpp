#include "collision_reason.hpp"

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense {

std::string collision_in_the_cut(const HostStackConfig& config, const CollisionConfig& axis,
                                 bool turns) {
  const bool unseen = !config.spindle.present && config.cut.unseen;
  if (!config.spindle.present && !unseen)
    return "; it knows of no spindle, so a cut would raise it, too";
  const bool told = config.spindle.present && config.cut.torque_Nm > 0;
  const std::string feed = turns
                               ? "below " + printed(rpm_from_rad_s(axis.maximum_feed_m_s)) + " rpm"
                               : "below " + printed(60 * axis.maximum_feed_m_s) + " m/min";
  const std::string where = told     ? "in the cut"
                            : unseen ? feed
                                     : feed + " with the spindle turning";
  const bool explained = axis.tool_radius_m > 0;
  if (axis.cutting_threshold_N_per_s > 0)
    return ", " + where + " beyond " + printed(axis.cutting_threshold_N_per_s) +
           (turns ? " Nm/s" : " N/s") +
           (explained ? " or where the torque cannot explain the force" : "");
  const char* const teach = "'servosense identify collision' teaches it a sound part";
  if (told)
    return explained ? "; in the cut only where the torque cannot explain the force, until " +
                           std::string(teach)
                     : "; in the cut it is unarmed until " + std::string(teach);
  return "; " + where +
         (explained ? " only where the torque cannot explain the force"
                    : " it is unarmed, for nothing tells cutting from air") +
         ": " +
         (unseen ? "record the spindle's motion and current or torque, then "
                 : "'servosense identify idle' learns cutting_torque_Nm, then ") +
         teach;
}

}  // namespace servosense
