#pragma once

#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <nodelet/nodelet.h>
#include <std_srvs/Trigger.h>

#include "acmp_mapping/ros/callback_thread.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/options.h"

namespace acmp {

/// What dense_mapper and map_server have alike: how they start and stop, their threads, services and warnings.
class NodeletBase : public nodelet::Nodelet {
 protected:
  /// Attaches everything to the threads, which run afterwards. What it throws ends the loading of the nodelet.
  virtual void Start() = 0;
  /// Of the private namespace, with those that others read allowed.
  ParameterReader ReadParameters();
  void WarnOfUnknown(const ParameterReader& reader);
  /// A private service whose answer has success and message: what handle(request, &response) throws becomes the message
  /// of a failure.
  /// @param doubt a clause that each answer ends with and that is warned of; may be empty
  template <class Service, class Handle>
  void AddService(CallbackThread* thread, const char* name, Handle handle,
                  const std::function<std::string()>& doubt = {}) {
    using Request = typename Service::Request;
    using Response = typename Service::Response;
    const boost::function<bool(Request&, Response&)> answer = [=](Request& request, Response& response) {
      try {
        handle(request, &response);
        response.success = true;
      } catch (const std::exception& error) {
        response = {};
        response.message = error.what();
      }
      const std::string clause = doubt ? doubt() : "";
      response.message += clause;
      if (!clause.empty()) NODELET_WARN("%s: %s", name, response.message.c_str());
      return true;
    };
    services_.push_back(thread->Attach(getPrivateNodeHandle()).advertiseService(name, answer));
  }
  /// A Trigger service. The handler returns what it did.
  void AddTrigger(CallbackThread* thread, const char* name, const std::function<std::string()>& handler) {
    AddService<std_srvs::Trigger>(thread, name, [=](const auto&, auto* response) { response->message = handler(); });
  }
  /// Counts it, and warns when it is time to.
  void Report(RejectedInput rejected);
  /// To be called by the destructor: afterwards no callback runs, nobody waits for one, and services are gone: some may
  /// be attached to threads of the derived class.
  void StopThreads();

  IncidentLog incidents_;
  const FailureReport report_failure_ = [this](const std::string& text) {
    Report(RejectedInput{"callback_failed", text});
  };

  // Before all others: what is attached to them goes before they do.
  CallbackThread input_thread_{report_failure_};
  CallbackThread service_thread_{report_failure_};  ///< handlers may take as long as a map takes to write
  CallbackThread urgent_thread_{report_failure_};   ///< for services that those shall not hold up
  CallbackThread status_thread_{report_failure_};

  std::vector<ros::ServiceServer> services_;

 private:
  void onInit() final;
};

}  // namespace acmp
