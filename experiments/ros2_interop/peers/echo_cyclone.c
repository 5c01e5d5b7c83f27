/* Sends back what comes, once a C struct has been made of it and bytes again: Cyclone DDS. TYPE names the type. */
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include "check.h"

#define JOIN(a, b) a##b
#define DESCRIPTOR(type) JOIN(type, _desc)

int main(int argc, char **argv)
{
  const int domain = atoi(argv[1]), count = atoi(argv[2]);
  dds_entity_t participant = dds_create_participant(domain, NULL, NULL);
  dds_qos_t *qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  dds_entity_t there = dds_create_topic(participant, &DESCRIPTOR(TYPE), "rt/check/there", NULL, NULL);
  dds_entity_t back = dds_create_topic(participant, &DESCRIPTOR(TYPE), "rt/check/back", NULL, NULL);
  dds_entity_t reader = dds_create_reader(participant, there, qos, NULL);
  dds_entity_t writer = dds_create_writer(participant, back, qos, NULL);
  dds_entity_t waitset = dds_create_waitset(participant);
  dds_entity_t condition = dds_create_readcondition(reader, DDS_ANY_STATE);
  if (argc != 3 || participant < 0 || there < 0 || back < 0 || reader < 0 || writer < 0)
    return 1;
  dds_waitset_attach(waitset, condition, 0);
  for (int done = 0; done < count;) {
    void *samples[1] = {NULL};
    dds_sample_info_t info[1];
    if (dds_waitset_wait(waitset, NULL, 0, DDS_SECS(60)) <= 0)
      return 2;
    const int taken = dds_take(reader, samples, info, 1, 1);
    if (taken == 1 && info[0].valid_data) {
      if (dds_write(writer, samples[0]) < 0)
        return 3;
      done++;
    }
    if (taken > 0)
      dds_return_loan(reader, samples, taken);
  }
  dds_wait_for_acks(writer, DDS_SECS(5));
  dds_delete(participant);
  return 0;
}
