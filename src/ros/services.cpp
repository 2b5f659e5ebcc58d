#include "acmp_mapping/ros/services.h"

#include <exception>
#include <utility>

#include <std_srvs/Trigger.h>

namespace acmp {

ros::ServiceServer AdvertiseTrigger(ros::NodeHandle nh, const char* name, std::function<std::string()> handler) {
  using std_srvs::Trigger;
  const boost::function<bool(Trigger::Request&, Trigger::Response&)> callback =
      [handler = std::move(handler)](Trigger::Request&, Trigger::Response& response) {
        try {
          response.message = handler();
          response.success = true;
        } catch (const std::exception& error) {
          response.success = false;
          response.message = error.what();
        }
        return true;
      };
  return nh.advertiseService(name, callback);
}

}  // namespace acmp
